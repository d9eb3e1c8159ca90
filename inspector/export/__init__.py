"""Exports of results: JSON documents, CSV, figures."""
