"""Every published table and figure of the thesis beside what the code gives now."""
