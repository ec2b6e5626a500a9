"""What has become of a cell over its life: each run against the cell as it was, false alarms held down over all."""
