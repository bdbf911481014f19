"""The page that a person looks at while moving the target: served by the live node itself."""
