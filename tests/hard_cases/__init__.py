"""Hard cases: every member of `tests/cases.py` through every kind of extreme.

`subjects` names the tensors of a member, `kinds` says how they are made hard, `bank` runs a member
and says what came out, `table` writes it into `docs/hard-cases.md`.
"""
