"""Every equation, table, figure and stated finding of the thesis, run and judged; `python -m reproduction`."""
