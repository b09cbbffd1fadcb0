"""What the commands do and say; `lapwing.cli` gives them their names and options."""
