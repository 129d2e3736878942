"""The arm's mathematics: model, kernel, identification, verification, diagnosis."""
