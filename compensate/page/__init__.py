"""The page that compares methods: pictures, their maps, and what a viewer does with them."""
