"""The thesis's loop in numbers, and which facts about it are tested where."""

DT = 0.01  # s
WINDOW = 8192  # samples of the measurement window
NK = 29  # tau_e f_s and the sample of the zero-order hold
PERIOD = 81.92  # s
INTENSITIES = (0.05, 0.10, 0.15, 0.20, 0.25, 0.30)

RECURSION = "recursion, in facts/test_thesis_recursion.py"

# Names in facts.json that are not in support/thesis_numbers.py, by their beginning.
NOT_HERE = {
    "rls.": RECURSION,
    "fig13.": RECURSION,
    "fig14.": RECURSION,
    "rls_vs_ols.": RECURSION,
    "P_theta.": RECURSION,
    "appI.RLS": RECURSION,
    "appI.": "accuracies of frequency responses, in interpret/test_fourier.py",
    "sensitivity.": "no tolerance: what the thesis leaves open",
    "timing.": "no tolerance: see benchmarks/",
    "G1.Kn.H4.C2.P0.30": "no tolerance: ill-posed, see test_unreachable_intensity_is_refused",
    "fig10.signs": "no tolerance: see test_signs_of_the_bias",
    "fig12.": "a claim on VAF, neither K_n nor delay nor bias",
    "fig11.": "a reading of a plot, neither K_n nor delay nor bias",
    "T53.filtered_better": "a claim on VAF, neither K_n nor delay nor bias",
    **{
        f"fig9.nk_star.C2.{cell}": "marked not reproduced"
        for cell in ("H3.P0.20", "H3.P0.25", "H3.P0.30", "H4.P0.25", "H4.P0.30")
    },
}


def flat(value):
    if isinstance(value, dict):
        return [number for part in value.values() for number in flat(part)]
    return (
        [number for part in value for number in flat(part)] if isinstance(value, list) else [value]
    )
