"""From the shaker to a recording: accelerometer boards and function generators on serial lines.

`fasbody record` runs the protocol of section 2.2.2 and writes a study folder. docs/acquisition.md describes
what a board has to send. Only port.py imports pyserial.
"""
