"""What the parameters of the shipped models are, in words: the page says them before the thesis symbol."""

WORDS = {
    "k_T": "ankle stiffness", "c_T": "ankle damping", "k_F": "fat pad stiffness", "c_F": "fat pad damping",
    "c_11": "ankle damping", "c_12": "its decay with stretch", "c_13": "its wave over stretch",
    "c_21": "fat pad damping", "c_22": "its decay with stretch", "c_23": "its wave over stretch",
    "k_11": "fascia stiffness, relaxed", "k_12": "fascia stiffness, fast part", "c_1": "fascia damping",
    "k_2": "apex stiffness", "k_3": "navicular stiffness", "k_4": "midfoot stiffness",
    "c_2": "apex damping", "c_3": "navicular damping", "c_4": "midfoot damping",
    "m_S": "shank mass", "m_T": "shank mass", "m_F": "foot mass",
}  # fmt: skip
