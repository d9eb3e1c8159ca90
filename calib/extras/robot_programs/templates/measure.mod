MODULE {{ program }}
{% for line in heading %}
  ! {{ line }}
{% endfor %}
  ! Joint values in degrees. Every move ends at rest (fine).
  ! The joint values that were reached go to HOME:{{ program }}.csv, written anew at each run.
{% if trigger.kind == "socket" %}
  ! Sockets take the controller's option PC Interface.
{% endif %}
{% for point in points %}
  CONST jointtarget {{ point.name }}:=[[{{ point.deg | digits(7, ",") }}],[9E9,9E9,9E9,9E9,9E9,9E9]];{% if point.label != point.name %}  ! {{ point.label }}{% endif %}

{% endfor %}
  CONST speeddata slow:=[{{ speed | digits(3) }},30,{{ speed | digits(3) }},30];
  VAR iodev joints_file;
{% if trigger.kind == "socket" %}
  VAR socketdev instrument;
  VAR string answer;
{% endif %}

  PROC run_{{ program }}()
    AccSet 30,30;
    Open "HOME:" \File:="{{ program }}.csv",joints_file \Write;
    Write joints_file,"pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg";
{% if trigger.kind == "socket" %}
    SocketCreate instrument;
    SocketConnect instrument,"{{ trigger.host }}",{{ trigger.port }};
{% endif %}
{% for pose in poses %}
{% if pose.ask %}
{% for line in pose.ask | wrapped(70) %}
    TPWrite "{{ line }}";
{% endfor %}
    Stop;
{% endif %}
{% for point in pose.way %}
    MoveAbsJ {{ point.name }}\NoEOffs,slow,fine,{{ tool_name or "tool0" }};
{% endfor %}
    MoveAbsJ {{ pose.name }}\NoEOffs,slow,fine,{{ tool_name or "tool0" }};
    measure_here "{{ pose.label }}";
{% endfor %}
{% if trigger.kind == "socket" %}
    SocketClose instrument;
{% endif %}
    Close joints_file;
  ENDPROC

  PROC measure_here(string label)
    VAR jointtarget joints;
    WaitTime\InPos,{{ settle_s | digits(3) }};
{% if measured.kind == "input" %}
    WaitDI {{ measured.signal }},0;
{% endif %}
    joints:=CJointT();
    Write joints_file,label+","+NumToStr(joints.robax.rax_1,4)+","+NumToStr(joints.robax.rax_2,4)+","\NoNewLine;
    Write joints_file,NumToStr(joints.robax.rax_3,4)+","+NumToStr(joints.robax.rax_4,4)+","\NoNewLine;
    Write joints_file,NumToStr(joints.robax.rax_5,4)+","+NumToStr(joints.robax.rax_6,4);
{% if trigger.kind == "output" %}
    PulseDO\PLength:={{ pulse_s | digits(3) }},{{ trigger.signal }};
{% elif trigger.kind == "socket" %}
    SocketSend instrument\Str:=label+"\0A";
{% endif %}
{% if measured.kind == "input" %}
    WaitDI {{ measured.signal }},1;
{% elif measured.kind == "reply" %}
    SocketReceive instrument\Str:=answer\Time:=WAIT_MAX;
{% else %}
    WaitTime {{ stand_s | digits(3) }};
{% endif %}
  ENDPROC
ENDMODULE
