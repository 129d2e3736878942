"""The page: one arm, live, in a browser. A process of its own, fed by Zenoh."""
