"""Cards of published policies: values from the results of a run, and templates with the text around them."""
