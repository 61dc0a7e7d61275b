"""Files of logs, read safely: CSV, Parquet, XML, protocol buffers and pickles."""
