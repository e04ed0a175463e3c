"""What parts owe one another: protocols, contexts, and the records of columns that flow between them."""
