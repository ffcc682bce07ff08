"""What everything else stands on: records, errors, equations of the shutter, geometry."""
