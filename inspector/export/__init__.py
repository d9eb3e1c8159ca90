"""JSON documents, CSV, PNG and GLB."""
