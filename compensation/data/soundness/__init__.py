"""What is wrong with readings before anybody asks about the arm: temperatures, turns, times."""
