"""Least squares, by hand: a handful of coefficients."""
import math


class Undetermined(Exception):
    """What the points do not distinguish."""


def least_squares(rows: list[list[float]], values: list[float]) -> list[float]:
    """Coefficients for which rows × coefficients is nearest to values; raises Undetermined."""
    size = len(rows[0]) if rows else 0
    if len(rows) < max(size, 1):
        raise Undetermined(f"{len(rows)} points for {size} coefficients")
    system = [[sum(row[i] * row[j] for row in rows) for j in range(size)] + [sum(row[i] * value for row, value in zip(rows, values))]
              for i in range(size)]
    scales = [system[i][i] for i in range(size)]
    for i in range(size):
        pivot = max(range(i, size), key=lambda k: abs(system[k][i]))
        system[i], system[pivot] = system[pivot], system[i]
        if abs(system[i][i]) <= 1e-9 * max(scales):
            raise Undetermined("what is varied does not vary by itself in these points")
        for k in range(size):
            if k != i:
                factor = system[k][i] / system[i][i]
                system[k] = [a - factor * b for a, b in zip(system[k], system[i])]
    return [system[i][size] / system[i][i] for i in range(size)]


def fit(points: list[dict], terms: tuple[str, ...], value: str) -> dict:
    """value = a + the sum of a coefficient for each term; with the residual's root mean square and largest. A term that never
    changes in these points is part of the constant and left out."""
    varied = [term for term in terms if len({point[term] for point in points}) > 1]
    rows = [[1.0, *(point[term] for term in varied)] for point in points]
    values = [point[value] for point in points]
    found = least_squares(rows, values)
    residuals = [seen - sum(a * b for a, b in zip(found, row)) for seen, row in zip(values, rows)]
    return {"constant": found[0], "terms": dict(zip(varied, found[1:])), "points": len(points),
            "residual_rms": math.sqrt(sum(one * one for one in residuals) / len(residuals)),
            "residual_max": max(map(abs, residuals))}


def formula(name: str, found: dict) -> str:
    terms = "".join(f" {'-' if factor < 0 else '+'} {abs(factor):.2f} {term}" for term, factor in found["terms"].items())
    return (f"{name:<14} = {found['constant']:.2f}{terms}    "
            f"(residual {found['residual_rms']:.2f} rms, {found['residual_max']:.2f} at most, {found['points']} points)")
