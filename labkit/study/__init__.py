"""Speed against error: designed studies of what a setting gains and costs."""
