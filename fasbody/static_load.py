"""The old name of `python -m fasbody.arch load`, for one release."""

if __name__ == "__main__":
    from fasbody.arch.__main__ import moved

    moved("fasbody.static_load", "load")
