"""placeholder"""

from reproduction.row import Rows

ROWS = Rows()
