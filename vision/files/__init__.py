"""What is read from disk and written to it: pictures, directories of views, strict JSON.

In: paths; out: values, or an error that names the field.
"""
