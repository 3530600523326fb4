"""Behaviour trees with the semantics of BehaviorTree.CPP 4: nodes, ports, blackboard, scripts, XML, checks, Groot2.

This room imports nothing of mazeplan but errors. `behavior` has the leaves that move a ball.
"""
