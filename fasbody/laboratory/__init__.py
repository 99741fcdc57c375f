"""A virtual laboratory: synthetic recordings and whole studies with known truth; `fasbody laboratory`."""
