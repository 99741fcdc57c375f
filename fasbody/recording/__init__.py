"""Recordings and studies: what a file holds, how it was made, and whether it can serve.

Whatever is wrong with a file or a table is an `InputFileError` that names the file and says what
would be valid; a recording that was read and cannot serve is a `RecordingError`.
"""
