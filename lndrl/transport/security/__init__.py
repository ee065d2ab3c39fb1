"""Who a session is (``identity``), by which papers (``certificates``), and what it may do."""
