"""Smooth curves: splines, their basis and their roughness."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from skhoid.effects.free_form import LEVEL, SLOPE, SmoothCurve

KNOTS = (-2.0, -0.9, -0.2, 0.1, 0.4, 1.1, 3.0)


def test_a_curve_is_the_natural_spline_and_a_line_beyond():
    rng = np.random.default_rng(0)
    values = rng.normal(size=len(KNOTS))
    curve = SmoothCurve(KNOTS)
    spline = CubicSpline(KNOTS, values, bc_type="natural")
    at = np.linspace(-2.0, 3.0, 50)
    np.testing.assert_allclose(curve(values, at), spline(at), atol=1e-12)
    beyond = np.array([3.0, 3.5, 4.0, 4.5])
    np.testing.assert_allclose(np.diff(curve(values, beyond), 2), 0.0, atol=1e-12)
    assert curve(values, beyond)[0] == pytest.approx(values[-1])


def test_the_basis_is_orthonormal_at_the_knots_and_its_roughness_is_the_integral():
    curve = SmoothCurve(KNOTS)
    rough = curve.basis[:, 2:]
    np.testing.assert_allclose(rough.T @ rough / len(KNOTS), np.eye(len(KNOTS) - 2), atol=1e-10)
    np.testing.assert_allclose(rough.T @ curve.basis[:, :2], 0.0, atol=1e-9)
    integrals = []
    for column in rough.T:
        spline = CubicSpline(KNOTS, column, bc_type="natural")
        at = np.linspace(KNOTS[0], KNOTS[-1], 200_001)
        integrals.append(np.trapezoid(spline(at, 2) ** 2, at))
    np.testing.assert_allclose(curve.roughness[2:], np.array(integrals) / integrals[0], rtol=1e-6)


@pytest.mark.parametrize(("kept", "fewer"), [((LEVEL, SLOPE), 0), ((LEVEL,), 1), ((), 2)])
def test_what_is_not_kept_is_no_part_of_any_curve(kept, fewer):
    basis = SmoothCurve(KNOTS, kept).basis
    assert basis.shape == (len(KNOTS), len(KNOTS) - fewer)
    flat = np.stack([np.ones(len(KNOTS)), np.array(KNOTS) - np.mean(KNOTS)])
    missing = [i for i in (LEVEL, SLOPE) if i not in kept]
    np.testing.assert_allclose(flat[missing] @ basis, 0.0, atol=1e-9)
