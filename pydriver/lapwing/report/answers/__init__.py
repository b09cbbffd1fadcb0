"""The findings that a summary begins with, from the evidence of all studies together."""
