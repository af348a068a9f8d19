"""The store: SQLAlchemy, a file a table family; only here rows and core objects are both known."""
