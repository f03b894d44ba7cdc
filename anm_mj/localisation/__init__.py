"""Where the camera is: between the robot and the map, observations get the pose that the map confirms.

An observation comes with a prior (wheel odometry, or none for a camera in the hand). A :class:`~.localiser.Localiser`
registers it to the neural field and hands it on with the estimated pose, its covariance and a quality.
"""
