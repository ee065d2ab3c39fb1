"""A robot that speaks ROS 2, without ROS: messages, links, driving, shapes, recordings."""
