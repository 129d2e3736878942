"""The arm in time, whatever the wire: who moves it, what is felt and counted, what goes wrong."""
