"""Do dense and loose specimens reach one critical state in drained tests?"""
