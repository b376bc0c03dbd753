"""Steps by which the schema came to be; run by `merap.knowledge.schema`."""
