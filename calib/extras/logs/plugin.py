"""What the extra brings: recordings by time as a source of an import."""

from __future__ import annotations

from calib.dataset_import.sources import ImportSource

_HERE = "calib.extras.logs"

CONTRIBUTIONS = (
    ImportSource(
        owns=f"{_HERE}.import_source:is_recorded",
        folder_marks=("metadata.yaml", "meta/info.json"),
        judged=f"{_HERE}.import_source:judged",
        describe=f"{_HERE}.table_logs:describe_table",
        reads=f"{_HERE}.recorded_stops:is_recording",
        tables=f"{_HERE}.recorded_stops:with_recorded_poses",
    ),
)
