"""Who may send what, and what became of it: chunks in, accounts and a ledger of every one."""
