"""Damaged and unclosed bags: looked through from the first byte on, and what is good in them made a bag again."""
