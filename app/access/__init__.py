"""Who may do what: the guard of every request, tokens, sessions, roles, audit."""
