"""Exports of results: JSON documents, CSV, PNG and GLB."""
