"""Diagnosis of many datasets: each processed on any executor, then compared by arm and searched for shared causes."""
