"""The filter of boost and coast, in square-root form: how targets move, and how looks are taken in."""
