"""The store: SQLAlchemy, one file per table family. Only this package converts rows to objects."""
