"""Names of the numbers that tell of a motion's stability, for studies, result files and figures."""

# Numbers of one motion: name -> UDUNITS, long name.
NUMBERS = {
    "lyapunov_exponent": (
        "1", "largest Lyapunov exponent per unit of tau = natural_frequency * t"),
    "lyapunov_exponent_error": (
        "1", "95 % half width, or of a periodic motion the change from one repetition to the next"),
    "lyapunov_exponent_effective": (
        "1", "independent mesh cycles that would tell as much of the exponent"),
    "lyapunov_exponent_per_cycle": ("1", "largest Lyapunov exponent per mesh cycle"),
    "second_lyapunov_exponent": (
        "1", "second Lyapunov exponent per unit of tau, -inf: lost in chatter or rest"),
    "tangent_rank": (
        "1", "numbers of a deviation that are left: 2, 1 after chatter, 0 after rigid rest"),
    "near_grazes": ("1", "recorded mesh cycles with an impact too near to grazing"),
    "determinant_defect": ("1", "check: determinant of a cycle's map against its factors"),
    "sum_rule_defect": ("1", "check: determinant against impacts and time in contact"),
}
STABILITY = NUMBERS | {
    "multiplier_real": ("1", "Floquet multipliers over one repetition, real parts"),
    "multiplier_imag": ("1", "Floquet multipliers over one repetition, imaginary parts"),
}
