"""What findings are worth on readings that took no part."""
