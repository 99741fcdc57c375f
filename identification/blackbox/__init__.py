"""Black-box identification of recordings (thesis Chapter 3).

`fasbody blackbox FILES` is the command; from Python, read a `data.Series`, examine its
excitation with `excitation.examine`, estimate with `pem.estimate` or `subspace.estimate`, and validate the result with
`candidate.judge` and `validation.residual_test`; `identify.identify` does all of this.
"""
