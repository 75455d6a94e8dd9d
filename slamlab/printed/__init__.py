"""Formulas as the papers print them, refuted: for chapters and tests, one file a paper."""
