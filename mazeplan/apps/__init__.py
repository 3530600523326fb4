"""What people use: the commands, reports, the page, the Gymnasium environment, the test kit for trees."""
