"""The motion that a free FE-DIC measures: data of the two-step method, and a start of the integrated one."""
