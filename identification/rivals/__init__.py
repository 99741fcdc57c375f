"""Rival models of the foot, compared on the same recordings: which departure of the world do they speak for?"""
