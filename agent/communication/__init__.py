"""Whom a robot hears, and what it tells them (paper III)."""
