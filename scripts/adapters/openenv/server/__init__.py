"""The server: `app` is the program, `grasp_environment` the environment, `settings` its configuration."""
