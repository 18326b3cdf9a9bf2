"""The ablation of the diagnosis: every threshold and every special procedure tried without, on a frozen sample."""
