"""A whole study: many fits, what they say together, and what they cannot know."""
