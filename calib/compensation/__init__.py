"""Corrected joint targets, with which the real arm goes where the nominal arm was commanded to go."""
