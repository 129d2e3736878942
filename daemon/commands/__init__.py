"""The commands of `armd`, one module each, in folders by kind; shared parts are here."""
