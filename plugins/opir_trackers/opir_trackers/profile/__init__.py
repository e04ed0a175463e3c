"""The tracker `boost-profile`: profiles of classes fitted to the looks of each track."""
