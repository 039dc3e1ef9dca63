"""Tasks in the pose space of one rig: what a network sees, what it shall return, how it is measured (PUMPS 5)."""
