"""What a diagnosis and an advice say: the facts of each sentence, and their words."""
