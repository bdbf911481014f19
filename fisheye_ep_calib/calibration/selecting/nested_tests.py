"""Whether further parameters of a richer structure are zero: p-values of nested tests."""

from __future__ import annotations

import numpy as np

from fisheye_ep_calib.calibration.estimating.adjustment import evaluate
from fisheye_ep_calib.calibration.estimating.fit import Fit, opened
from fisheye_ep_calib.calibration.estimating.normal_equations import (
    ALMOST_UNDAMPED,
    solve_damped,
    unbiased_view_robust_covariance,
)
from fisheye_ep_calib.calibration.structure import Structure

CLUSTERS_BEYOND_TERMS = 10  # views beyond the number of tested parameters that the view-robust test needs


def nested_test(rich: Fit, plain: Fit) -> float:
    """p-value for "a richer fit's further parameters are zero": the larger of two tests.

    The F test on the costs (Seber and Wild, Nonlinear Regression, 5.3) trusts that residuals are independent; those
    of one view share its pose, its lighting and its blur, so a Wald test whose covariance is built from whole views
    (Cameron and Miller, "A practitioner's guide to cluster-robust inference", J. Human Resources 50, 2015) must agree.
    With too few views for that the F test stands alone, its statistic divided by the clustering of the residuals.
    """
    extra = rich.structure.parameter_count - plain.structure.parameter_count
    if extra <= 0 or rich.degrees_of_freedom <= 0:
        return 1.0
    gain = plain.adjustment.equations.cost - rich.adjustment.equations.cost
    if len(rich.sightings.images) < extra + CLUSTERS_BEYOND_TERMS:
        return f_test(plain, gain, extra, rich.clustering)
    return max(f_test(plain, gain, extra), _wald_test(rich, plain))


def f_test(plain: Fit, gain: float, extra: int, clustering: float = 1.0) -> float:
    """p-value of a gain in cost, px², by ``extra`` parameters more than a fit's."""
    freedom = plain.degrees_of_freedom - extra
    rest = max(plain.adjustment.equations.cost - gain, 1e-300)
    return f_tail(extra, freedom, max(gain, 0.0) / extra / (clustering * rest / freedom))


def first_step_test(structure: Structure, plain: Fit) -> float:
    """As ``nested_test``, from what the first step of a richer structure's adjustment promises: Rao's score test.

    It costs one evaluation where a fit takes several, and says as much where there is little to gain (Rao, Math. Proc.
    Cambridge Phil. Soc. 44, 1948).
    """
    extra = structure.parameter_count - plain.structure.parameter_count
    if extra <= 0 or plain.degrees_of_freedom <= extra:
        return 1.0
    equations = evaluate(*opened(plain, structure, plain.sightings))
    try:
        return f_test(plain, solve_damped(equations, ALMOST_UNDAMPED).predicted_decrease, extra)
    except np.linalg.LinAlgError:  # nothing is known about them
        return 1.0


def _wald_test(rich: Fit, plain: Fit) -> float:
    """p-value of the parameters that a plainer fit lacks, from the view-robust covariance."""
    names, values = rich.shared_parameters
    plain_names, _ = plain.shared_parameters
    tested = [i for i, name in enumerate(names) if name not in plain_names]
    views = len(rich.sightings.images)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows says nothing, and is left out below
            covariance = unbiased_view_robust_covariance(rich.settled)[np.ix_(tested, tested)]
        if not np.isfinite(covariance).all():
            return 1.0
        statistic = values[tested] @ np.linalg.lstsq(covariance, values[tested], rcond=None)[0] / len(tested)
    except np.linalg.LinAlgError:  # nothing is known about them
        return 1.0
    return f_tail(len(tested), views - len(tested), statistic) if np.isfinite(statistic) else 1.0


def f_tail(extra: int, freedom: int, statistic: float) -> float:
    """P(F > statistic) with (extra, freedom) degrees of freedom."""
    from scipy.special import fdtrc  # scipy.stats would take half a second more to load

    return float(fdtrc(extra, freedom, statistic))
