"""Rival models of the foot, compared on the same recordings: which departure from the model do they support?"""
