"""Systems that are met online, and policies that adapt to them."""
