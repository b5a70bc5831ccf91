"""Writes data/chi2.txt: lines `probability degrees quantile`, 20 digits, from the incomplete gamma function (mpmath)."""
import pathlib

import mpmath as mp

mp.mp.dps = 40


def quantile(probability, degrees):
    p, a = mp.mpf(probability), mp.mpf(degrees) / 2

    def below(x):
        if p < 0.5:
            return mp.gammainc(a, 0, x / 2, regularized=True) < p
        return mp.gammainc(a, x / 2, mp.inf, regularized=True) > 1 - p

    low, high = mp.mpf("1e-30"), mp.mpf(degrees) + 300
    for _ in range(150):
        middle = mp.sqrt(low * high) if high > 2 * low else (low + high) / 2
        low, high = (middle, high) if below(middle) else (low, middle)
    return low


with open(pathlib.Path(__file__).parent / "data" / "chi2.txt", "w") as out:
    for degrees in (1, 2, 3, 4, 5, 6, 7, 10, 12, 30, 100):
        for p in (1e-9, 1e-3, 0.01, 0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.997, 0.999, 0.999999, 1 - 1e-9, 1 - 1e-12):
            print(repr(p), degrees, mp.nstr(quantile(p, degrees), 20), file=out)
