"""Writes data/reference.txt: reference values of the maps and Jacobians with 60 digits.

    python3 -m venv ENV && ENV/bin/pip install mpmath && ENV/bin/python reference_table.py

Every value comes from a matrix power series (exp, Jacobians), a matrix inverse (inverse Jacobians) or, for log, from
the quaternion's angle and that inverse; no closed form of the library under test is used. Inputs are f64 numbers, taken
exactly. One line a quantity:

    group quantity theta : inputs : values

Values are row-major. The quantities of SE(3), blocks of 3 x 3:
    exp       xi -> rotation, translation
    forward   xi -> J, Q of the left Jacobian [[J, Q], [0, J]]
    inverse   xi -> the same blocks of its inverse
    log       quaternion x y z w (normalised here), translation -> rho, phi
    adjoint   the same -> R, [t] R
and of SE(2): exp -> cos, sin, x, y; forward, inverse -> 2 x 2 block, third column's two; log and adjoint from
re im x y -> xi, and cos, sin, third column's two.
"""
import pathlib
import random

import mpmath as mp

mp.mp.dps = 90
DIGITS = 60
TERMS = 110


def series(a, shift):
    """sum a^k / (k + shift)!: exp for shift 0, the left Jacobian for shift 1."""
    term = mp.eye(a.rows)
    total = mp.eye(a.rows)
    for k in range(1, TERMS):
        term = term * a / (k + shift)
        total = total + term
    return total


def hat3(w):
    return mp.matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def block(m, row, column, rows=3, columns=3):
    return mp.matrix([[m[row + i, column + j] for j in range(columns)] for i in range(rows)])


def ad6(xi):
    p, r = hat3(xi[3:]), hat3(xi[:3])
    m = mp.zeros(6)
    for i in range(3):
        for j in range(3):
            m[i, j] = m[i + 3, j + 3] = p[i, j]
            m[i, j + 3] = r[i, j]
    return m


def ad3(xi):
    x, y, t = xi
    return mp.matrix([[0, -t, y], [t, 0, -x], [0, 0, 0]])


def hat4(xi):
    m = mp.zeros(4)
    p = hat3(xi[3:])
    for i in range(3):
        m[i, 3] = xi[i]
        for j in range(3):
            m[i, j] = p[i, j]
    return m


def hat_se2(xi):
    x, y, t = xi
    return mp.matrix([[0, -t, x], [t, 0, y], [0, 0, 0]])


def rotation_of(q):
    """Rotation matrix of a unit quaternion x y z w as exp(2 atan2(|v|, w) v / |v|)."""
    return series(hat3(rotation_vector(q)), 0)


def rotation_vector(q):
    n = mp.sqrt(sum(c * c for c in q[:3]))
    if n == 0:
        return [mp.mpf(0)] * 3
    w = q[3]
    angle = 2 * mp.atan2(n, abs(w)) * (-1 if w < 0 else 1)
    return [c * angle / n for c in q[:3]]


def text(values):
    return " ".join(mp.nstr(v, DIGITS, min_fixed=0, max_fixed=0, strip_zeros=True) for v in values)


def entries(m):
    return [m[i, j] for i in range(m.rows) for j in range(m.cols)]


def thetas(rng):
    found = [0.0]
    found += [m * 10.0**e for e in range(-12, -1) for m in (1.0, 3.0)] + [0.1]
    found += [rng.uniform(0.1, 6.28) for _ in range(18)]
    # both sides of where the library changes its formula
    found += [1.41, 1.42, 2.99, 3.01]
    found += [float(mp.pi - mp.mpf(10) ** -k) for k in range(13)] + [float(mp.pi)]
    found += [float(mp.pi + mp.mpf(10) ** -k) for k in (1, 3, 6)]
    found += [float(2 * mp.pi - mp.mpf(10) ** -k) for k in (0, 1, 2, 3)]
    return found


def exact(values):
    return [mp.mpf(v) for v in values]


def write(out, group, quantity, theta, inputs, values):
    print(f"{group} {quantity} {theta!r} : {' '.join(map(repr, inputs))} : {text(values)}", file=out)


def se3(out, rng, theta):
    axis = [rng.gauss(0, 1) for _ in range(3)]
    norm = sum(a * a for a in axis) ** 0.5
    xi = [rng.gauss(0, 1) for _ in range(3)] + [theta * a / norm for a in axis]
    x = exact(xi)
    m = series(hat4(x), 0)
    write(out, "se3", "exp", theta, xi, entries(block(m, 0, 0)) + entries(block(m, 0, 3, 3, 1)))
    j = series(ad6(x), 1)
    write(out, "se3", "forward", theta, xi, entries(block(j, 0, 0)) + entries(block(j, 0, 3)))
    i = j**-1
    write(out, "se3", "inverse", theta, xi, entries(block(i, 0, 0)) + entries(block(i, 0, 3)))

    half = mp.mpf(theta) / 2
    q = [float(mp.sin(half) * a / norm) for a in axis] + [float(mp.cos(half))]
    t = xi[:3]
    size = mp.sqrt(sum(c * c for c in exact(q)))
    unit = [c / size for c in exact(q)]
    phi = rotation_vector(unit)
    rho = series(hat3(phi), 1) ** -1 * mp.matrix(exact(t))
    write(out, "se3", "log", theta, q + t, list(rho) + phi)
    r = rotation_of(unit)
    write(out, "se3", "adjoint", theta, q + t, entries(r) + entries(hat3(exact(t)) * r))


def se2(out, rng, theta):
    xi = [rng.gauss(0, 1), rng.gauss(0, 1), theta]
    x = exact(xi)
    m = series(hat_se2(x), 0)
    write(out, "se2", "exp", theta, xi, [m[0, 0], m[1, 0], m[0, 2], m[1, 2]])
    j = series(ad3(x), 1)
    write(out, "se2", "forward", theta, xi, entries(block(j, 0, 0, 2, 2)) + [j[0, 2], j[1, 2]])
    i = j**-1
    write(out, "se2", "inverse", theta, xi, entries(block(i, 0, 0, 2, 2)) + [i[0, 2], i[1, 2]])

    pose = [float(mp.cos(theta)), float(mp.sin(theta))] + xi[:2]
    c, s, px, py = exact(pose)
    size = mp.sqrt(c * c + s * s)
    angle = mp.atan2(s, c)
    v = block(series(ad3([mp.mpf(0), mp.mpf(0), angle]), 1), 0, 0, 2, 2) ** -1 * mp.matrix([px, py])
    write(out, "se2", "log", theta, pose, [v[0], v[1], angle])
    write(out, "se2", "adjoint", theta, pose, [c / size, s / size, py, -px])


def main():
    rng = random.Random(20)
    path = pathlib.Path(__file__).parent / "data" / "reference.txt"
    with open(path, "w") as out:
        for theta in thetas(rng):
            for signed in (theta, -theta):
                se3(out, rng, signed)
                se2(out, rng, signed)


main()
