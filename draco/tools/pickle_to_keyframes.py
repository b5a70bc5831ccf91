#!/usr/bin/env python3
"""Turn recordings of the published system into a folder that `draco run --data` reads.

usage: pickle_to_keyframes.py OUT_DIR RECORDING_1.pickle [RECORDING_2.pickle ...] [--truth ROBOT=FILE.csv ...]

Each pickle is one robot: a dict with `poses` (x, y, theta a keyframe), `points` (n x 2 a keyframe, x forward) and
`time_stamps`. Other entries are left alone. A truth file has lines `time,x,y,theta`; a keyframe takes the line with its
own time stamp. `y` of the points is taken as it is unless --flip-y is given (the published front end writes y to
starboard, this program wants it to port).

Pickles can run any code when they are loaded. Here only numbers, containers, numpy arrays and time stamps are rebuilt;
objects of any other class become empty shells whose state is dropped, and no function is ever called.
"""
import argparse
import csv
import math
import os
import pickle
import struct
import sys


class Shell:
    """Stands for an object of a class that is not wanted; keeps its state if it has some."""

    def __init__(self, *_args, **_kwargs):
        pass

    def __setstate__(self, state):
        self.state = state


class Array(Shell):
    """A numpy array, rebuilt without numpy."""

    def __setstate__(self, state):
        _version, shape, dtype, fortran, data = state
        if fortran and len(shape) > 1:
            raise ValueError("an array in Fortran order")
        if isinstance(data, list):
            values = data
        else:
            code, size = dtype.code
            values = [v[0] for v in struct.iter_unpack("<" + code, data[: len(data) // size * size])]
        self.values = nested(values, list(shape))


def nested(values, shape):
    if len(shape) <= 1:
        return list(values)
    step = len(values) // shape[0] if shape[0] else 0
    return [nested(values[i * step:(i + 1) * step], shape[1:]) for i in range(shape[0])]


class DType(Shell):
    CODES = {"f8": ("d", 8), "f4": ("f", 4), "i8": ("q", 8), "i4": ("i", 4), "u1": ("B", 1), "O8": (None, 8)}

    def __init__(self, name, *_args):
        self.code = self.CODES.get(name)
        if self.code is None:
            raise ValueError(f"numpy type {name}")

    def __setstate__(self, _state):
        pass


class Scalar:
    def __new__(cls, dtype, data):
        return struct.unpack("<" + dtype.code[0], data)[0]


class Time(Shell):
    def __init__(self, secs=0, nsecs=0):
        self.seconds = secs + 1e-9 * nsecs

    def __setstate__(self, state):
        secs, nsecs = (state["secs"], state["nsecs"]) if isinstance(state, dict) else state
        self.seconds = secs + 1e-9 * nsecs


def reconstruct(_class, _shape, _kind):
    return Array()


class Reader(pickle.Unpickler):
    def find_class(self, module, name):
        if module.split(".")[0] == "numpy":
            known = {"_reconstruct": reconstruct, "ndarray": Array, "dtype": DType, "scalar": Scalar}
            if name in known:
                return known[name]
            raise pickle.UnpicklingError(f"{module}.{name} is not rebuilt")
        if name == "Time" and module.split(".")[0] in ("genpy", "rospy"):
            return Time
        if (module, name) == ("_codecs", "encode"):
            return lambda text, encoding: text.encode(encoding)
        return Shell


def plain(value):
    """Lists and numbers out of whatever holds them."""
    if isinstance(value, Array):
        return plain(value.values)
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value


def seconds(stamp):
    if isinstance(stamp, Time):
        return stamp.seconds
    if isinstance(stamp, (int, float)):
        return float(stamp)
    raise ValueError(f"a time stamp of type {type(stamp).__name__}")


def load(path):
    with open(path, "rb") as file:
        data = Reader(file, encoding="latin1").load()
    poses, points = plain(data["poses"]), plain(data["points"])
    stamps = data.get("time_stamps")
    stamps = plain(stamps) if stamps is not None else list(range(len(poses)))
    times = [seconds(stamp) for stamp in stamps]
    if not len(poses) == len(points) == len(times):
        raise ValueError(f"{len(poses)} poses, {len(points)} scans, {len(times)} time stamps")
    for pose in poses:
        if len(pose) != 3 or not all(math.isfinite(v) for v in pose):
            raise ValueError(f"a pose {pose}")
    return poses, points, times


def read_truth(path):
    with open(path, newline="") as file:
        rows = [[float(cell) for cell in row] for row in csv.reader(file) if row and not row[0].startswith("t")]
    return {round(row[0], 6): row[1:4] for row in rows}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--truth", action="append", default=[], metavar="ROBOT=FILE")
    parser.add_argument("--flip-y", action="store_true", help="points have y to starboard")
    arguments = parser.parse_args()
    truths = {int(name): read_truth(path) for name, path in (t.split("=", 1) for t in arguments.truth)}
    sign = -1.0 if arguments.flip_y else 1.0
    os.makedirs(arguments.out, exist_ok=True)
    with open(os.path.join(arguments.out, "keyframes.csv"), "w", newline="") as keyframes, \
            open(os.path.join(arguments.out, "points.csv"), "w", newline="") as scans:
        keyframes.write("robot,kf,time,dr_x,dr_y,dr_theta,gt_x,gt_y,gt_theta,n_points\n")
        scans.write("kf,x,y\n")
        kf = 0
        for robot, path in enumerate(arguments.recordings, start=1):
            try:
                poses, points, times = load(path)
            except Exception as error:  # whatever is wrong with the file is told with its name
                sys.exit(f"{path}: {error}")
            for (x, y, theta), scan, time in zip(poses, points, times):
                truth = truths.get(robot, {}).get(round(time, 6), ["", "", ""])
                row = [robot, kf, repr(time), repr(x), repr(y), repr(theta), *truth, len(scan)]
                keyframes.write(",".join(map(str, row)) + "\n")
                for point in scan:
                    scans.write(f"{kf},{point[0]!r},{sign * point[1]!r}\n")
                kf += 1


if __name__ == "__main__":
    main()
