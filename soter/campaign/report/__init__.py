"""Reports of a campaign: tables in words, pages, and the generated part of documents."""
