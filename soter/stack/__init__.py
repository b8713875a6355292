"""The application stack: task planner, robot agent, motion planner, plan executor and the safety modules."""
