"""The view feed: what a simulator shows of its cases."""
