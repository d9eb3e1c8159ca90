"""What a fit leaves over: held against every candidate effect, against faults of one joint, and against noise."""
