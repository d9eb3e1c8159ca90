"""Diagnosis of many datasets: each is processed on any executor, then arms are compared and shared causes sought."""
