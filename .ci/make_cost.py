"""Write a small float64 cost matrix in the .npy format without numpy."""
import struct
import sys

n = 30
header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({n}, {n}), }}"
header += " " * (-(10 + len(header) + 1) % 64) + "\n"
with open(sys.argv[1], "wb") as file:
    file.write(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode())
    file.write(struct.pack(f"<{n * n}d", *[(i * 7919 % 997) / 10 for i in range(n * n)]))
