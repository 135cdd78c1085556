function answer = correct(client, pose, twist)
%CORRECT  What to command instead of a desired pose, asked of a running `gpcorrect serve`.
%
%   MATLAB asks through the Python client of gpcorrect (pip install 'gpcorrect[service]'), in a process of its own:
%
%       pyenv(Version="/path/to/.venv/bin/python", ExecutionMode="OutOfProcess");
%       client = py.gpcorrect_service.CorrectionClient("tcp/127.0.0.1:7449", arm="PSM1", timeout=0.5);
%       answer = correct(client, [0.1 0.02 -0.11 1 0 0 0], [0.05 0 0 0 0 0]);
%       robot.move(answer.position, answer.quaternion)        % yours
%       client.close();
%
%   POSE is x y z (m) and the unit quaternion w x y z, TWIST the velocity (m/s, rad/s) or []. A refusal, and silence,
%   is a MATLAB error whose message says what to do. Keep one client: it is held to the model that answered it first.
arguments
    client
    pose (1, 7) double
    twist double = []
end
asked = py.list(num2cell(pose));
if isempty(twist)
    reply = client.correct(asked);
else
    reply = client.correct(asked, twist=py.list(num2cell(twist)));
end
answer.position = double(py.array.array('d', reply.position.tolist()));
answer.quaternion = double(py.array.array('d', reply.quaternion.tolist()));
answer.interval95 = double(py.array.array('d', reply.interval95.tolist()));  % m and rad, NaN where nothing was learned
answer.in_domain = logical(reply.in_domain);
answer.status = string(reply.status);
answer.reason = string(reply.reason);
end
