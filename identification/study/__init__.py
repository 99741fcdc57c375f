"""A whole study at once: every subject, load and frequency, on one machine or a cluster, resumable.

`fasbody study STUDY`. One fit is one JSON document in OUT/fits; summary, figures
and report are made from those.
"""

#: Which recordings one fit takes together.
MODES = ("per-recording", "pooled")
#: What is done with such a group: the fit itself, or a check of it.
KINDS = ("fit", "profile", "validation", "agreement")
#: How well an estimate is known, best first.
VERDICTS = ("identified", "weak", "not identifiable")
