"""Ground floor: names, codes, arguments, messages; every room may use it."""
