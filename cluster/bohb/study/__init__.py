"""What a study is: its definition, which never changes, and its journal, which grows."""
