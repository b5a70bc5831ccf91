"""Grades the digits of the example lie_eval from outside, on inputs the committed table does not hold.

    ENV/bin/python grade_lie_eval.py TARGET/release/examples/lie_eval [SEED]        (ENV has mpmath)

References are matrix power series and linear solves with 60 digits. For log and adjoint the input matrix is the exact
one rounded to f64, and two references are told apart: `true`, the tangent (or matrix) before rounding, and `input`,
that of the nearest rotation of the rounded matrix (polar factor by Newton's iteration). Prints for each operation,
group and block the largest error over the largest entry of the block, and the angle it is at; at a half turn both
signs of the axis are right.
"""
import random
import subprocess
import sys

import mpmath as mp

mp.mp.dps = 60


def hat3(w):
    return mp.matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def hat(group, x):
    if group == "so2":
        return mp.matrix([[0, -x[0]], [x[0], 0]])
    if group == "so3":
        return hat3(x)
    d = 2 if group == "se2" else 3
    spin = hat("so%d" % d, x[d:])
    m = mp.zeros(d + 1)
    for i in range(d):
        m[i, d] = x[i]
        for j in range(d):
            m[i, j] = spin[i, j]
    return m


def ad(group, x):
    if group == "so2":
        return mp.zeros(1)
    if group == "so3":
        return hat3(x)
    if group == "se2":
        return mp.matrix([[0, -x[2], x[1]], [x[2], 0, -x[0]], [0, 0, 0]])
    m = mp.zeros(6)
    p, r = hat3(x[3:]), hat3(x[:3])
    for i in range(3):
        for j in range(3):
            m[i, j] = m[i + 3, j + 3] = p[i, j]
            m[i, j + 3] = r[i, j]
    return m


def series(a, shift):
    term = mp.eye(a.rows)
    total = mp.eye(a.rows)
    for k in range(1, 90):
        term = term * a / (k + shift)
        total = total + term
    return total


def polar(r):
    for _ in range(6):
        r = (r + (r ** -1).T) / 2
    return r


def adjoint(group, m):
    if group == "so2":
        return mp.eye(1)
    if group == "so3":
        return m
    if group == "se2":
        return mp.matrix([[m[0, 0], m[0, 1], m[1, 2]], [m[1, 0], m[1, 1], -m[0, 2]], [0, 0, 1]])
    r = m[0:3, 0:3]
    tr = hat3([m[i, 3] for i in range(3)]) * r
    a = mp.zeros(6)
    for i in range(3):
        for j in range(3):
            a[i, j] = a[i + 3, j + 3] = r[i, j]
            a[i, j + 3] = tr[i, j]
    return a


def log(group, m):
    """Logarithm of an exact group element by Newton's method from the antisymmetric part is not stable at pi, so the
    rotation goes by its quaternion, the translation by a linear solve with the Jacobian's power series."""
    d = 2 if group[2] == "2" else 3
    r = m[0:d, 0:d]
    if d == 2:
        phi = [mp.atan2(r[1, 0], r[0, 0])]
    else:
        q = [mp.sqrt(max(0, 1 + s0 * r[0, 0] + s1 * r[1, 1] + s2 * r[2, 2]))
             for s0, s1, s2 in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
        k = max(range(4), key=lambda i: q[i])
        full = mp.matrix([[1 + r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
                          [0, 1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
                          [0, 0, 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1]],
                          [0, 0, 0, 1 - r[0, 0] - r[1, 1] + r[2, 2]]])
        q = [full[min(k, j), max(k, j)] for j in range(4)]
        if q[0] < 0:
            q = [-c for c in q]
        n = mp.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        phi = [mp.mpf(0)] * 3 if n == 0 else [2 * mp.atan2(n, q[0]) * c / n for c in q[1:]]
    if group[1] == "o":
        return phi
    v = series(hat("so%d" % d, phi), 1)
    rho = mp.lu_solve(v, m[0:d, d])
    return list(rho) + phi


def blocks(op, group, values):
    """Splits row-major values into named parts, so that a small block does not hide behind a large one."""
    n = {"so2": 1, "se2": 3, "so3": 3, "se3": 6}[group]
    d = {"so2": 2, "se2": 2, "so3": 3, "se3": 3}[group]
    s = n - d * (d - 1) // 2 if group[1] == "e" else 0
    if op == "log":
        return {"rho": values[:s], "phi": values[s:]}
    columns = d + (group[1] == "e") if op == "exp" else n
    split = d if op == "exp" else s
    rows = [values[i:i + columns] for i in range(0, len(values), columns)]
    if split == 0:
        return {"R": values}
    top = rows[:split]
    return {"R": [x for r in top for x in r[:split]], "t": [x for r in top for x in r[split:]],
            "rest": [x for r in rows[split:] for x in r]}


def thetas(rng):
    yield 0.0
    for e in range(-12, 0):
        yield 10.0 ** e
        yield rng.uniform(1, 10) * 10.0 ** e
    for _ in range(30):
        yield rng.uniform(0, 6.28)
    for k in range(13):
        yield float(mp.pi - mp.mpf(10) ** -k)
    yield float(mp.pi)
    for k in range(0, 7):
        yield float(mp.pi + mp.mpf(10) ** -k)
    for k in range(4):
        yield float(2 * mp.pi - mp.mpf(10) ** -k)


def main():
    program, seed = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 1
    rng = random.Random(seed)
    requests, references, angles = [], [], []

    def ask(op, group, inputs, theta, **reference):
        requests.append(" ".join([op, group] + [repr(float(x)) for x in inputs]))
        references.append((op, group, reference))
        angles.append(theta)

    for theta in thetas(rng):
        for sign in (1, -1):
            for group in ("so2", "se2", "so3", "se3"):
                d = int(group[2])
                axis = [rng.gauss(0, 1) for _ in range(1 if d == 2 else 3)]
                norm = sum(a * a for a in axis) ** 0.5
                phi = [sign * theta] if d == 2 else [sign * theta * a / norm for a in axis]
                x = ([rng.gauss(0, 1) for _ in range(d)] if group[1] == "e" else []) + phi
                exact = [mp.mpf(c) for c in x]
                m = series(hat(group, exact), 0)
                jl = series(ad(group, exact), 1)
                jr = series(-ad(group, exact), 1)
                ask("exp", group, x, sign * theta, true=list(m))
                for op, value in (("jl", jl), ("jr", jr), ("jl_inv", jl ** -1), ("jr_inv", jr ** -1)):
                    ask(op, group, x, sign * theta, true=list(value))
                rounded = [float(c) for c in m]
                element = mp.matrix(m.rows, m.cols)
                for i, c in enumerate(rounded):
                    element[i // m.cols, i % m.cols] = mp.mpf(c)
                p = polar(element[0:d, 0:d])
                for i in range(d):
                    for j in range(d):
                        element[i, j] = p[i, j]
                ask("log", group, rounded, sign * theta, true=log(group, m), input=log(group, element))
                ask("adjoint", group, rounded, sign * theta, true=list(adjoint(group, m)),
                    input=list(adjoint(group, element)))
    output = subprocess.run([program], input="\n".join(requests) + "\n", capture_output=True, text=True, check=True)
    lines = output.stdout.splitlines()
    assert len(lines) == len(requests), (len(lines), len(requests))
    worst = {}
    for line, (op, group, reference), theta in zip(lines, references, angles):
        found = [mp.mpf(w) for w in line.split()]
        for name, values in reference.items():
            values = list(values)
            candidates = [values]
            if op == "log" and group == "so3" and abs(abs(theta) - mp.pi) < 1e-12:
                candidates.append([-c for c in values])
            errors = []
            for candidate in candidates:
                a, b = blocks(op, group, found), blocks(op, group, candidate)
                errors.append({k: float(max([abs(x - y) for x, y in zip(a[k], b[k])], default=0)
                                        / (max([abs(y) for y in b[k]], default=0) or 1)) for k in b})
            best = min(errors, key=lambda e: max(e.values()))
            for k, e in best.items():
                key = (op, group, k, name)
                if e >= worst.get(key, (-1, 0))[0]:
                    worst[key] = (e, theta)
    for key, (error, theta) in sorted(worst.items()):
        print("%-8s %-4s %-4s %-6s %.2e  at %r" % (*key, error, theta))
    print(len(requests), "requests, worst", max(worst.values()))


main()
