"""Processes of moments, instruments and air that nobody has modelled, as plugins of Brv-Hypo."""
