"""The ego follows its lane from the beginning on: does it stay in the middle?"""
