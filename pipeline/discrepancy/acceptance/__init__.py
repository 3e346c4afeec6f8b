"""Tests on confirmation rows, which no fit and no selection saw."""
