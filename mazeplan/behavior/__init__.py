"""The behaviour tree: nodes with BehaviorTree.CPP semantics, trees from XML, and the leaves that move the ball."""
