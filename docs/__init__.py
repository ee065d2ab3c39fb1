"""The pages; ``docs.site`` makes a site of them."""
