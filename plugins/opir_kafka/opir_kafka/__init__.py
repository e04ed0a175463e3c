"""The Kafka sink for opir."""
