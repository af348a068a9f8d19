"""The store: SQLAlchemy, one file a table family; only here both rows and core objects are known."""
