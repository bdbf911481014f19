"""The files a recording is made of: one module a format, each listing its images without reading them."""
