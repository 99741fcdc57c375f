"""The experiment director: the next recording worth making, a whole session in advance, and the fit while shaking."""
