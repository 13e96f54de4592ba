"""Columns of a measured test, by the letters of its quantities."""

QUANTITIES = {
    **{"e1": "axial_strain", "ev": "volumetric_strain", "s1": "axial_stress", "s3": "radial_stress"},
    **{"q": "deviatoric_stress", "p": "mean_stress", "u": "pore_pressure", "e": "void_ratio"},
}


def of_columns(**letters):
    """`e1="eps:%"` becomes "axial_strain": ("eps", "%", "compression"); without a unit it is that of the file."""
    columns = {}
    for letter, text in letters.items():
        header, unit, sign = [*text.split(":"), "", ""][:3]
        positive = () if letter in ("u", "e") else (sign or "compression",)
        columns[QUANTITIES[letter]] = (header, unit or None, *positive)
    return columns
