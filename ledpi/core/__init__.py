"""The ground on which everything else stands: records, errors, equations of the shutter, geometry."""
