"""The same work as the benchmarks, done by other packages (extra ``bench``)."""
